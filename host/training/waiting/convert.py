import sys,torch,json,zlib,struct,numpy as np
from safetensors.numpy import save
from model import *
src,dst,widths,steps=sys.argv[1],sys.argv[2],sys.argv[3],sys.argv[4]
net=Net(tuple(map(int,widths.split(','))),True,'4'); net.load_state_dict(torch.load(src)); net.eval()
perm=[]
for i in range(8):
    m=torch.eye(2,dtype=torch.long)
    if i&1: m=torch.tensor([[-1,0],[0,1]])@m
    if i&2: m=torch.tensor([[1,0],[0,-1]])@m
    if i&4: m=torch.tensor([[0,1],[1,0]])@m
    perm.append(idx(m))
def p(n): return torch.tensor([f*8+k for f in range(n//8) for k in perm])
T={}
for n,l in net.W.items():
    w=l.w().detach()
    o,i=(1,0) if l.t else (0,1)
    if n!='output': w=w.index_select(o,p(w.shape[o]))
    if n!='encode20a': w=w.index_select(i,p(w.shape[i]))
    T[n+'.weight']=w.contiguous().numpy()
    if n!='output':
        b=net.N[n].bn; r=lambda t:t.detach().repeat_interleave(8).numpy()
        T[n+'.norm.gamma']=r(b.weight);T[n+'.norm.beta']=r(b.bias);T[n+'.norm.mean']=r(b.running_mean);T[n+'.norm.variance']=r(b.running_var)
T['output.bias']=(net.bias*torch.tensor([0.,0.,1.])).detach().numpy()
meta=dict(json.loads((lambda f:f[8:8+struct.unpack('<Q',f[:8])[0]])(open('../../network/weights/tracked.safetensors','rb').read()))['__metadata__']); meta.pop('crc32')
meta['manifest']=json.dumps({"framework":"PyTorch","sample_steps":float(steps),"minutes":0.0}); meta['widths']=widths
if len(sys.argv)>5: meta['contact_min_n'],meta['friction']=sys.argv[5:7]
d=save(T,meta); n=struct.unpack('<Q',d[:8])[0]; data=d[8+n:]
c=0
for k in sorted(meta): c=zlib.crc32(f'{k}={meta[k]}\n'.encode(),c)
c=zlib.crc32(data,c); meta['crc32']=f'{c:08x}'
d2=save(T,meta); n2=struct.unpack('<Q',d2[:8])[0]; assert d2[8+n2:]==data
open(dst,'wb').write(d2); print('ok',meta['crc32'])
